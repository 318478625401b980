"""The reference of the public API: what `dbc`, `daq` and `identify` offer by name."""

from importlib.metadata import version as version_of

from sphinx.application import Sphinx

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


def _of_another_page(
    app: Sphinx, what: str, name: str, obj: object, skip: bool, options: object
) -> bool | None:
    """Leave out what a package to the left defines: its own page has it."""
    home = getattr(obj, "__module__", "").split(".")[0]
    return True if home in ("dbc", "daq", "identify") and home != app.env.docname else None


def setup(app: Sphinx) -> None:
    """Connect the choice of members."""
    app.connect("autodoc-skip-member", _of_another_page)
