"""What a person looks at: the offline HTML report, and still pictures of motions."""
