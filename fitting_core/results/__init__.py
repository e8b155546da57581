"""What a fit returns, and what it was given: values alone, which are computed elsewhere."""
