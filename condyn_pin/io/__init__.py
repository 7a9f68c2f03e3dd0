"""Robot descriptions: readers and writers of files."""
