"""What the page of studies computes: each file here is one study, and all that its form and its page need."""
