//! Where to grip a soft object and how to move it so that its hidden side turns up: null-space grips, turning over, stretching
