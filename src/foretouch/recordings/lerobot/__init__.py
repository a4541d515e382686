"""From recordings to a LeRobotDataset: what each says frame by frame, and the folder that holds all of them."""
