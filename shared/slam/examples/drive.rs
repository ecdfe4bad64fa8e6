//! A log through SLAM: `drive LOG OUT [reference]`.
use std::io::Write as _;
use echogrid_core::{Pose2, OdometryConfig};
use echogrid_formats::log::{self, LogEvent};
use echogrid_slam::{Points, Slam, SlamConfig};
fn arg(k: &str, d: f64) -> f64 { for a in std::env::args() { if let Some(v) = a.strip_prefix(&format!("{k}=")) { return v.parse().unwrap() } } d }
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let path = std::path::Path::new(&a[1]);
    let survey = log::survey(path).unwrap();
    let mut config = SlamConfig::default();
    config.closure_score_min = arg("min", config.closure_score_min);
    config.closure_margin = arg("margin", config.closure_margin);
    config.closure_every_m = arg("every", config.closure_every_m);
    config.refine_rounds = arg("rounds", 3.0) as u32;
    if arg("noodo", 0.) > 0. { config.odometry = echogrid_slam::UseOdometry::Ignore }
    let (wl, wa) = (arg("wl", 0.), arg("wa", 0.));
    let t0 = std::time::Instant::now();
    let mut slam = Slam::new(&config, &OdometryConfig::default());
    let mut odom: Vec<(u64, Pose2)> = vec![]; let mut pend: std::collections::VecDeque<(u64, Vec<echogrid_core::Reading>)> = Default::default();
    let mut prev: Option<(Pose2, Pose2)> = None; let mut nscan = 0; let mut way = 0.0;
    for e in log::open(path, &survey).unwrap() {
        match e.unwrap() {
            LogEvent::Odometry { stamp_ns, odom_from_base, .. } => {
                let o = match prev { None => odom_from_base, Some((r, w)) => { let i = echogrid_core::Increment::between(r, odom_from_base); way += i.length_m(); echogrid_core::move_by(w, i.corrected(-wl, -wa)) } };
                prev = Some((odom_from_base, o)); odom.push((stamp_ns, o));
                while pend.front().is_some_and(|p| p.0 <= stamp_ns) { let (t, r) = pend.pop_front().unwrap(); step(&mut slam, &odom, t, &survey.robot, &r) }
            }
            LogEvent::Scan { stamp_ns, readings } => { nscan += 1; if odom.last().is_some_and(|o| o.0 >= stamp_ns) { step(&mut slam, &odom, stamp_ns, &survey.robot, &readings) } else { pend.push_back((stamp_ns, readings)) } }
            LogEvent::TruePose { .. } => {}
        }
    }
    let t1 = t0.elapsed().as_secs_f64();
    let applied = slam.closures.iter().filter(|c| c.standing == echogrid_slam::closures::Standing::Applied).count();
    eprintln!("{nscan} scans, {} nodes, {:.0} m (odometry {way:.0}), lost {}, tries {}, found {} applied {} ambiguous {}, scales {:?}, {t1:.1} s", slam.nodes.len(), slam.nodes.last().unwrap().way_m, slam.lost, slam.tries, slam.closures.len(), applied, slam.ambiguous, slam.graph.scales);
    if arg("v", 0.) > 0. { for c in &slam.closures { eprintln!("{:?} {}->{} gap {:.0} loop {:.0} {} {} score {:.2} inl {:.2} rms {:.3} off {:.2} {:.3} support {}", c.standing, c.to, c.from, slam.nodes[c.to as usize].way_m - slam.nodes[c.from as usize].way_m, c.loop_m, c.is_strong, c.slides.is_some(), c.score, c.inliers, c.rms_m, c.off.0, c.off.1, c.support) } }
    let save = |slam: &Slam, name: String| { let mut f = std::io::BufWriter::new(std::fs::File::create(name).unwrap()); for (n, p) in slam.nodes.iter().zip(&slam.graph.poses) { writeln!(f, "{:.6} {} {} {}", n.stamp_ns as f64 * 1e-9, p.x, p.y, p.theta).unwrap() } };
    slam.solve(); save(&slam, format!("{}.graph", a[2]));
    slam.finish(); save(&slam, format!("{}.fine", a[2]));
    eprintln!("total {:.1} s, scales {:?}", t0.elapsed().as_secs_f64(), slam.graph.scales);
    let mut f = std::io::BufWriter::new(std::fs::File::create(format!("{}.pts", a[2])).unwrap());
    for (n, p) in slam.nodes.iter().zip(&slam.graph.poses) { for q in &n.points.at { let w = p.transform(*q); writeln!(f, "{:.3} {:.3}", w[0], w[1]).unwrap() } }
}
fn step(slam: &mut Slam, odom: &[(u64, Pose2)], t: u64, robot: &echogrid_core::Robot, r: &[echogrid_core::Reading]) {
    let k = odom.partition_point(|o| o.0 < t); let at = if k == 0 { odom[0].1 } else if k == odom.len() { odom[k - 1].1 } else { let (p, q) = (&odom[k - 1], &odom[k]); p.1.interpolate(q.1, (t - p.0) as f64 / (q.0 - p.0).max(1) as f64) };
    if slam.wants(at) { slam.add(t, at, Points::of(robot, r, |_| Pose2::IDENTITY)); }
}
