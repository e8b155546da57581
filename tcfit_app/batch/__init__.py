"""Many clips: a list of them, who fits them, and what is known about each when it is stopped and started again."""
