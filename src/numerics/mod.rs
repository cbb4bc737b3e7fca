//! Numerical methods, independent of the rod: linear solvers, Newton's method, time integration.

pub mod linear;

pub mod system;

pub mod newton;

pub mod integrator;
