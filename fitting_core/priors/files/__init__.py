"""Pose priors as files: tcfit's own format and VPoser's, without running anything in them."""
