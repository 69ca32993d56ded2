"""What goes over the wire, as pure functions: bytes or descriptions in, values out, and back."""
