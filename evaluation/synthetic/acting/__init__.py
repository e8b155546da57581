"""From a script to the poses of a body: limbs, hands, contact with the floor, and what goes wrong for a detector."""
