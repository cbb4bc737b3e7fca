//! The rod and all that acts on it, which know no time step; a [`model`] is all of them as one system.

pub mod rod;

pub mod actuation;

pub mod fluid;

pub mod loads;

pub mod head;

pub mod tendons;

pub mod start;

pub mod model;

pub mod drives;
