"""What people see: of each result its sentences, tables, figures, page, JSON; data in, plain records out."""
