"""Classical G-buffer of a recorded frame, from the image and LiDAR, without learned weights."""
