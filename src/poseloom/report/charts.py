"""The program that draws a page's charts in the browser; it travels within the page, so that none needs a network."""

from importlib.util import find_spec

from poseloom.errors import missing_extra

NO_CHARTS = missing_extra("the charts of a report are drawn by plotly", "report")
"""What is wrong where the extra `report` is not installed."""


def has_charts() -> bool:
    """Whether the extra `report` is installed."""
    return find_spec("plotly") is not None


def require_charts() -> None:
    """Called before long work that ends in a page.

    Raises:
        PoseloomError: if the extra `report` is not installed; it says how to install it.
    """
    if not has_charts():
        raise NO_CHARTS


def chart_script() -> str:
    """The program, as JavaScript.

    Raises:
        PoseloomError: if the extra `report` is not installed.
    """
    require_charts()
    from plotly.offline import get_plotlyjs  # pyright: ignore[reportMissingTypeStubs]

    return get_plotlyjs()
