"""Motion capture as poses of the body: reading, retargeting, and leaving out what nobody can do."""
