"""What does the paper claim? Its experiment, with statistics."""
