"""Several people before one camera, who cross, hide each other, leave and come back; who is who is known."""
