"""From the rows of a study to its summary and conclusions."""
