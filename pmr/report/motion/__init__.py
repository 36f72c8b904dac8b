"""How a motion is shown: pictures, and players for the page."""
