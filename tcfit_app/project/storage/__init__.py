"""How a project is stored, safely across crashes."""
