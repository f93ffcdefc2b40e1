"""Judgement of recorded data before a model is fitted: one question a file, a table of them in `advise`."""
