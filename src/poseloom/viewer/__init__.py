"""A browser page that shows figures: of a live session as it goes on, and of recordings along their time."""
