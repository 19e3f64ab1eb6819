"""What the methods share: Allan deviation, stepwise regression, compensation files, processes."""
