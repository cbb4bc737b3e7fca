//! The rod and everything that acts on it, without time steps; a [`model`] combines them into one system.

pub mod rod;

pub mod actuation;

pub mod fluid;

pub mod loads;

pub mod head;

pub mod tendons;

pub mod start;

pub mod model;

pub mod drives;
