"""Settings of a fit: their types and presets, names and ranges, and TOML files."""
