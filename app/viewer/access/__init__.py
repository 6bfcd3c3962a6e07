"""Who may open the page: addresses, tokens, roles, and limits on connections."""
