"""What answers are judged by: oracles of their own, second readers, random machines."""
