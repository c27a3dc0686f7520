"""What readers of robots share: links and joints of a file become bodies and joints of a builder."""
