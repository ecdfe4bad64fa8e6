//! What comes to the live page: the head of a request, or a message of a viewer. None is answered that does not know the token, and an
//! order that is understood is of a place that can be.
#![no_main]

use echogrid_live::access::{Access, Route};
use echogrid_live::protocol::Said;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let access = Access { token: "secret".into(), hosts: vec!["rover.local".into()] };
    if let Ok(Route::Page | Route::Socket(_)) = access.judge(bytes) {
        assert!(bytes.windows(12).any(|piece| piece == b"token=secret"), "shown to who does not know the token");
    }
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(Said::Fix { x, y, theta, sigma_m, sigma_rad, .. }) = Said::parse(text) {
        assert!([x, y, theta, sigma_m, sigma_rad].iter().all(|number| number.is_finite()));
    }
});
