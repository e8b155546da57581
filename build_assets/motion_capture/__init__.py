"""Motion capture as poses of the body: reading, retargeting, and dropping impossible poses."""
