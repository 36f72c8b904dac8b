"""Files that are whole or not there, whatever ends the process that wrote them, and read as data, never obeyed."""
