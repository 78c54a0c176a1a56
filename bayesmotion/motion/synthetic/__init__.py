"""Made-up people who walk, dance and talk, with the truth known."""
