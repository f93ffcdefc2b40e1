"""Motions of several models under the same signals, compared by peak and rms in windows of time."""
