"""From the fit's skeleton onto a rig: turns from rest to rest, feet that stand, hands that touch."""
