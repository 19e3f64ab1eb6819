"""What is on disk: the bench file, the record of a run, its catalogue, import and export."""
