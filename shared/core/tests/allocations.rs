//! Once it has seen the place, a mapper takes readings in without asking for memory.

#![allow(clippy::expect_used, reason = "tests")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use echogrid_core::grid::Grid;
use echogrid_core::kernel::{EchoCone, FanKernel, FirstEchoKernel, Kernel};
use echogrid_core::sensor_model::{Cone, Deviations};
use echogrid_core::{Pose2, first_echo::FirstEcho};

thread_local! {
    static ASKED: Cell<u64> = const { Cell::new(0) };
}

/// Counts how often a thread asks the system for memory.
struct Counting;

// SAFETY: all is passed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ASKED.try_with(|asked| asked.set(asked.get() + 1));
        // SAFETY: as of this function.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as of this function.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A way round, with cones of all lengths, some of them thin.
fn drive(mut add: impl FnMut(Pose2, f64, f64, bool)) {
    for k in 0..400u32 {
        let (s, c) = libm::sincos(0.05 * f64::from(k));
        let leaves_gaps = k % 4 == 0;
        let aperture_rad = if leaves_gaps { 0.004 } else { core::f64::consts::FRAC_PI_6 };
        add(Pose2::new(3.0 * c, 2.0 * s, 0.37 * f64::from(k)), 0.3 + 0.011 * f64::from(k), aperture_rad, leaves_gaps);
    }
}

#[test]
fn no_reading_asks_for_memory_in_steady_state() {
    let mut grid = Grid::new(0.05);
    let (mut kernel, mut first_echo) = (Kernel::new(0.0, 8.0), FirstEchoKernel::new(0.0, 8.0));
    let mut fan = FanKernel::new(0.0, 8.0);
    let mut round = || {
        let before = ASKED.get();
        drive(|pose, range_m, aperture_rad, leaves_gaps| {
            let sigma_theta_rad = 0.5 * aperture_rad;
            let deviations = Deviations { sigma_z_m: 0.05, sigma_theta_rad, trust: 0.5 };
            let (p_occupied, p_free, range_cap_m) = (0.85, 0.3, 5.0);
            let cone = Cone { range_m, aperture_rad, range_cap_m, deviations, p_occupied, p_free, leaves_gaps };
            assert!(kernel.add(&mut grid, pose, &cone, 1).is_ok());
            let beam =
                Cone { aperture_rad: 0.01, deviations: Deviations { sigma_theta_rad: 0.005, ..deviations }, ..cone };
            let beams: [_; 40] = core::array::from_fn(|n| (n as u16 * 3, beam));
            assert!(fan.add(&mut grid, pose, 0.01, &beams, 1).is_ok());
            let range_m = (range_m < 4.5).then_some(range_m);
            let (sigma_z_m, detection, clutter, lost) = (0.05, 0.2, 0.4, 0.9);
            let reading = FirstEcho { range_m, sigma_z_m, sigma_theta_rad, detection, clutter, range_cap_m, lost };
            let cone = EchoCone { reading, aperture_rad, prior_log_odds: -4.6, weight: 1.0, leaves_gaps };
            assert!(first_echo.add(&mut grid, pose, &cone, 1).is_ok());
        });
        ASKED.get() - before
    };
    assert!(round() > 0, "the counter counts");
    assert_eq!(round(), 0);
}
