"""Plans flown over links, watched and judged: the only room that sees plan and link together."""
