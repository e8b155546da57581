"""How fast a fit is: what is measured, by whom, and how two measurements compare."""
