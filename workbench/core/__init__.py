"""What every room stands on: errors, records, YAML with places, runs, tables."""
