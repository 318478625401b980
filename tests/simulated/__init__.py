"""Cars and campaigns that only tests simulate: named cars, a fleet of plausible ones, sessions."""
