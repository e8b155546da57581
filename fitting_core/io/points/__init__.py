"""Named points over time in files of laboratories, TRC and C3D, and tables of the feet's contacts."""
