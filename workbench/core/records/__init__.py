"""Options and records: text, JSON, CSV."""
