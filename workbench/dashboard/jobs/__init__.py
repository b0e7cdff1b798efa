"""Long work outside the page: processes that outlive a reload, their progress and their files."""
