"""The hand space of the free bodies, from recorded hands and postures."""
