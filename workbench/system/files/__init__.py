"""Systems in files: TOML, SSP."""
