//! Spawns the full process graph, as users do.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr)] // a test that can not go on has failed

mod bad_input;
mod by_hand;
mod calibrate;
mod cuts;
mod demo;
mod disk_full;
mod doctor;
mod drive;
mod experiment;
mod failure;
mod filters;
mod frames;
mod going_on;
mod harness;
mod kills;
mod languages;
mod lidar;
mod live;
mod localization;
mod log;
mod looking_in;
mod maps;
mod pioneer;
mod privacy;
mod range_sensors;
mod real_logs;
mod recorder;
mod score;
mod second_user;
mod sensors;
mod shutdown;
mod simulator;
mod supervision;
mod support;
mod talk;
mod topic;
mod walls;
mod why;
