"""Files that are written completely or not at all, and readers that treat every file as data of unknown origin."""
