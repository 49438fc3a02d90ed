"""The paper's open questions, one module each, and the answers that a recording gives to them."""
