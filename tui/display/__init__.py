"""A page for phone, tablet or TV at the bench."""
