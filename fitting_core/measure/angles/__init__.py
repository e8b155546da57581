"""Joint angles by the recommendations of the ISB, and the same motion as coordinates of an OpenSim model."""
