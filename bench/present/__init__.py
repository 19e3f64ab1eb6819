"""What people see: commands, reports, the panel."""
