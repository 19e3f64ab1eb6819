"""What drivers are made of: links, conversations, framing, instrument protocols."""
