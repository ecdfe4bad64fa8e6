use super::*;

fn odometry_key(change: impl FnOnce(&mut OdometryConfig)) -> Option<&'static str> {
    let mut config = OdometryConfig::default();
    change(&mut config);
    config.validate().err().map(|e| e.key)
}

fn mapper_key(change: impl FnOnce(&mut MapperConfig)) -> Option<&'static str> {
    let mut config = MapperConfig::default();
    change(&mut config);
    config.validate().err().map(|e| e.key)
}

#[test]
fn defaults_are_valid() {
    assert_eq!(odometry_key(|_| {}), None);
    assert_eq!(mapper_key(|_| {}), None);
}

#[test]
fn odometry_names_the_wrong_key() {
    assert_eq!(odometry_key(|c| c.lin_scale = 1.0), Some("lin_scale"));
    assert_eq!(odometry_key(|c| c.lin_scale = f64::NAN), Some("lin_scale"));
    assert_eq!(odometry_key(|c| c.lin_offset_m = f64::INFINITY), Some("lin_offset_m"));
    assert_eq!(odometry_key(|c| c.lin_offset_from_turn_rad = -1.0), Some("lin_offset_from_turn_rad"));
    assert_eq!(odometry_key(|c| c.ang_scale = -1.5), Some("ang_scale"));
    assert_eq!(odometry_key(|c| c.ang_offset_rad = f64::NAN), Some("ang_offset_rad"));
    assert_eq!(odometry_key(|c| c.ang_offset_from_travel_m = f64::NAN), Some("ang_offset_from_travel_m"));
    assert_eq!(odometry_key(|c| c.k_ll = -1e-9), Some("k_ll"));
    assert_eq!(odometry_key(|c| c.k_lt = f64::NAN), Some("k_lt"));
    assert_eq!(odometry_key(|c| c.k_tt = f64::INFINITY), Some("k_tt"));
    assert_eq!(odometry_key(|c| c.k_tl = -1.0), Some("k_tl"));
}

#[test]
fn mapper_names_the_wrong_key() {
    for wrong in [0.0, -0.05, 0.0009, 10.1, f64::NAN, f64::INFINITY] {
        assert_eq!(mapper_key(|c| c.resolution_m = wrong), Some("resolution_m"), "{wrong}");
    }
    assert_eq!(mapper_key(|c| c.log_odds_max = 0.0), Some("log_odds_max"));
    assert_eq!(mapper_key(|c| c.log_odds_max = f64::NAN), Some("log_odds_max"));
    assert_eq!(mapper_key(|c| c.log_odds_prior = 8.5), Some("log_odds_prior"));
    assert_eq!(mapper_key(|c| c.log_odds_prior = f64::NAN), Some("log_odds_prior"));
    for wrong in [0.5, 1.0, 0.2, f64::NAN] {
        assert_eq!(mapper_key(|c| c.p_occupied = wrong), Some("p_occupied"), "{wrong}");
    }
    for wrong in [0.0, 0.5, 0.7, f64::NAN] {
        assert_eq!(mapper_key(|c| c.p_free = wrong), Some("p_free"), "{wrong}");
    }
    assert_eq!(mapper_key(|c| c.min_range_m = Limit::Metres(-0.1)), Some("min_range_m"));
    assert_eq!(mapper_key(|c| c.max_range_m = Limit::Metres(0.0)), Some("max_range_m"));
    assert_eq!(mapper_key(|c| c.max_range_m = Limit::Metres(f64::NAN)), Some("max_range_m"));
    let crossed = mapper_key(|c| {
        c.min_range_m = Limit::Metres(2.0);
        c.max_range_m = Limit::Metres(1.0);
    });
    assert_eq!(crossed, Some("min_range_m"));
    assert_eq!(mapper_key(|c| c.min_trust = 1.1), Some("min_trust"));
    assert_eq!(mapper_key(|c| c.min_trust = f64::NAN), Some("min_trust"));
    for wrong in [0.0, 1.0, f64::NAN] {
        assert_eq!(mapper_key(|c| c.echo_prior = wrong), Some("echo_prior"), "{wrong}");
        assert_eq!(mapper_key(|c| c.oriented_prior = wrong), Some("oriented_prior"), "{wrong}");
        assert_eq!(mapper_key(|c| c.echo_detection = wrong), Some("echo_detection"), "{wrong}");
        assert_eq!(mapper_key(|c| c.echo_clutter = wrong), Some("echo_clutter"), "{wrong}");
        assert_eq!(mapper_key(|c| c.echo_lost = wrong), Some("echo_lost"), "{wrong}");
    }
    assert_eq!(mapper_key(|c| c.tempering = -0.1), Some("tempering"));
    assert_eq!(mapper_key(|c| c.oriented_tempering = -0.1), Some("oriented_tempering"));
    assert_eq!(mapper_key(|c| c.oriented_looks = 0.5), Some("oriented_looks"));
    assert_eq!(mapper_key(|c| c.oriented_place_m = 0.001), Some("oriented_place_m"));
    assert_eq!(mapper_key(|c| c.oriented_wall_m = 0.001), Some("oriented_wall_m"));
    assert_eq!(mapper_key(|c| c.novelty_m = f64::NAN), Some("novelty_m"));
    assert_eq!(mapper_key(|c| c.tiles_every_s = -0.1), Some("tiles_every_s"));
    assert_eq!(mapper_key(|c| c.remap_readings_max = 3), Some("remap_readings_max"));
    assert_eq!(mapper_key(|c| c.keep_readings_max = 0), Some("keep_readings_max"));
    assert_eq!(mapper_key(|c| c.remap_readings_max = u32::MAX), Some("remap_readings_max"));
    assert_eq!(mapper_key(|c| c.filters.push(Filter::Range)), Some("filters"));
    assert_eq!(mapper_key(|c| c.filters.clear()), None);
    let unused = |c: &mut MapperConfig| c.filters = vec![Filter::Bubble];
    assert_eq!(mapper_key(|c| (unused(c), c.max_range_m = Limit::Metres(3.0)).1), Some("filters"));
    assert_eq!(mapper_key(|c| (unused(c), c.sonars = SonarSelection::Numbers(vec![1])).1), Some("filters"));
    assert_eq!(mapper_key(|c| c.filter_rings = 101), Some("filter_rings"));
    assert_eq!(mapper_key(|c| c.bubble_rings = 101), Some("bubble_rings"));
    assert_eq!(mapper_key(|c| c.stuck_after_m = -1.0), Some("stuck_after_m"));
    assert_eq!(mapper_key(|c| c.lone_tolerance_m = f64::NAN), Some("lone_tolerance_m"));
    assert_eq!(mapper_key(|c| c.bubble_tolerance_m = f64::INFINITY), Some("bubble_tolerance_m"));
}

#[test]
fn message_tells_what_to_do() {
    let error = MapperConfig { p_free: 0.7, ..MapperConfig::default() }.validate().unwrap_err();
    assert_eq!(error.to_string(), "p_free = 0.7: expected a probability between 0 and 0.5, both excluded");
}
