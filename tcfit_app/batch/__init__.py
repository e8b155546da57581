"""Fits many clips: their list, the processes that fit them, and what is found done when a stopped batch continues."""
