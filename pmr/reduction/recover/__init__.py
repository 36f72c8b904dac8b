"""Full coordinates, fields and stresses from reduced coordinates."""
