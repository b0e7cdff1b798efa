"""The results of a study on disk: folder, index, manifest."""
