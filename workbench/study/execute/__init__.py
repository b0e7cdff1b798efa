"""Running a study: in one go or in chunks that resume."""
