"""What `report` writes of a finished study."""
