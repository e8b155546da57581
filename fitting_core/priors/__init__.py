"""Pose priors: L2 around a pose, or a learned latent space."""
