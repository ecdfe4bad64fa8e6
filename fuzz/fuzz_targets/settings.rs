//! Any lines as settings of the command line: what is taken can be shown, and means the same when it is written down and read
//! again. A line is what stands after `--set`, or another option with what stands after it.
#![no_main]

use std::path::PathBuf;

use echogrid_config::{Config, LoadRequest, render};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    // Whatever can be named is looked at; a device might never end.
    if text.contains("dev") || text.contains("proc") {
        return;
    }
    let mut request = LoadRequest { base: Some(PathBuf::from("/nowhere")), ..LoadRequest::default() };
    for line in text.lines() {
        let (option, value) = line.split_once(' ').unwrap_or((line, ""));
        let field = match option {
            "--robot" => &mut request.robot,
            "--rate" => &mut request.rate,
            "--out" => &mut request.out,
            "--domain" => &mut request.domain,
            "--sensor" => &mut request.sensor,
            "--fix" => &mut request.fix,
            "--record" => &mut request.record,
            "--fix-every" => {
                request.fix_every = value.parse().ok();
                continue;
            }
            _ => {
                request.sets.push(line.to_owned());
                continue;
            }
        };
        *field = Some(value.to_owned());
    }
    match Config::load(&request) {
        Ok(loaded) => {
            assert!(!render(&loaded).is_empty());
            let written = loaded.config().to_toml().expect("what was taken can be written");
            assert_eq!(&Config::from_toml(&written).expect("what was written can be read"), loaded.config());
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
