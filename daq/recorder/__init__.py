"""Runs the recorder: threads at the edge, pure folds inside."""
