"""Tests of the operator's terminal."""
