"""What ``highfive stream`` does: listens to a live system, shows how well it comes, and records it."""
