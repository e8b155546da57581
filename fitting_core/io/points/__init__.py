"""Named points over time in laboratories' files, TRC and C3D, and tables of foot contacts."""
