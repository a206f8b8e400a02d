"""MAVLink FTP, the ground station's side."""
