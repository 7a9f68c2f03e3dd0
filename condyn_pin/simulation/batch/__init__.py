"""Many states at once: chunks over an executor, arrays in, arrays out."""
