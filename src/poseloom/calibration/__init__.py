"""Finding out, from a few held poses, how large a person is and where the sensors sit."""
