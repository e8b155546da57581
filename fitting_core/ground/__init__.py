"""Which way is up, which foot stands, and where the floor lies, of one clip."""
