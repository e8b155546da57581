"""How far off a fit's joints and angles may be: from the normal equations, through a table of what was measured."""
