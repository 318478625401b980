"""The report: the results of a session for people, as HTML, PDF and figures."""
