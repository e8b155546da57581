"""Which way is up, which foot stands, and where the floor lies, of one clip of a camera that does not move."""
