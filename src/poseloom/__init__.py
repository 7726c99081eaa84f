"""poseloom weaves a full-body human motion from what a few body-worn sensors say."""

__version__ = "0.1.0"
