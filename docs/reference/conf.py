"""The reference of the public API: what `dbc`, `daq` and `identify` offer by name."""

from importlib.metadata import version as version_of

project = "Bumpbench"
version = release = version_of("bumpbench")
html_title = f"Bumpbench {version}"

extensions = ["sphinx.ext.autodoc", "numpydoc"]
html_theme = "alabaster"
html_theme_options = {"page_width": "1100px"}
html_copy_source = False

# Every member in the order of the source; types stand in the signature, once.
autodoc_default_options = {"members": True, "imported-members": True, "undoc-members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
