"""The body model: its parameters, kinematics, mesh, points with derivatives, and the ranges of its joints."""
