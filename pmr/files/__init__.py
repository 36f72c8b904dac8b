"""Files that are written in whole or not at all, and readers that treat every file as data of unknown origin."""
