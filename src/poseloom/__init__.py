"""poseloom weaves a full-body human motion from what a few body-worn sensors say."""
