"""Fits many clips: their list, the processes that fit them, and the records from which a stopped batch goes on."""
