"""The recorder: threads at the edge, pure folds within."""
