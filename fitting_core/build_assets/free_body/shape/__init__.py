"""The shape space of the free bodies, from MakeHuman's phenotypes."""
