"""From recorded data to a validated linear model (source report, chapters 5.3 to 5.6)."""
