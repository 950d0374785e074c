"""Tables, figures and the page that a person looks at."""
