"""The report: what a session says of its vehicle, for people, as HTML, PDF and figures.

`content.report_of` gathers it, `html.html_of` and `pdf.write_pdf` set it; both show the same
blocks in the same order.
"""
