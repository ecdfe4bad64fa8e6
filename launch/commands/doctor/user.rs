//! Who runs it.

use echogrid_topics::domain::User;

use super::finding::Finding;

/// Root may do anything, and so may break anything; a graph needs nothing of that.
pub(super) fn judge(user: &User) -> Finding {
    if user.uid != 0 {
        return Finding::ok("user", user.to_string());
    }
    let text = "root: maps will be root's files, and graphs of other users stay out of reach (leave their files in \
                /dev/shm alone)";
    Finding::warning("user", text, "run it as the user of the robot: sudo -u USER echogrid …")
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn root_is_warned() {
        assert_eq!(judge(&User { uid: 0, name: Some("root".into()) }).verdict, Verdict::Warning);
        assert_eq!(judge(&User { uid: 1000, name: None }).verdict, Verdict::Ok);
    }
}
