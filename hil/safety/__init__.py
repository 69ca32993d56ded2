"""What may be sent to the arm that meets people: limits, states, and what each of them protects against."""
