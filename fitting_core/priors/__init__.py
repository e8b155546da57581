"""What a likely pose is: L2 around a pose, or a learned latent space."""
