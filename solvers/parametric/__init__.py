"""One plate cell as a function of its sizes: reduced bases over a whole box of designs."""
