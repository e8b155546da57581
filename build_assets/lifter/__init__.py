"""What trains the lifter: captured motion, filmed by cameras of all kinds through a detector that errs."""
