"""Body models as files: finding, reading and checking them."""
