"""What a browser tab shows of the review app."""
