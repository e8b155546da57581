"""Errors to expect in a fit's joints and angles: from the normal equations, calibrated by measurements."""
