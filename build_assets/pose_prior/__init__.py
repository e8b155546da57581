"""What trains the pose prior: motion capture, brought onto the body's joints."""
