"""Which way is up, which foot stands, and where the floor is, in one clip."""
